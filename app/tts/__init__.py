"""From text to speech with phone times: one file an engine, one registry."""

from __future__ import annotations

import os

# Read when onnxruntime is loaded: without it, it reports usage to its maker and keeps a device id in the home folder.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
