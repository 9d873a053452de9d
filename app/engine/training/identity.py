"""Who an avatar is, and whether the person shown agreed: asked for before any work is done."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from app.engine.pack import Consent
from app.errors import TrainingFailed


class Identity(BaseModel):
    """What a pack says of itself beyond what is measured; `avatar.json` holds one."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")
    title: str = Field(min_length=1)
    voice: str
    licence: str = Field(min_length=1)
    provenance: str = Field(min_length=1)
    consent: Consent


def read_identity(path: Path) -> Identity:
    """Read an `avatar.json`.

    Raises:
        TrainingFailed: it is missing, no JSON, or lacks something; says what.
    """
    if not path.exists():
        raise TrainingFailed(
            f"{path} is missing: an avatar needs a name, a voice, and the consent of the person shown",
            advice="See docs/training.md for what to write into it.",
        )
    try:
        described: Any = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise TrainingFailed(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise TrainingFailed(f"{path} is no JSON: {error}") from error
    try:
        return Identity.model_validate(described)
    except ValidationError as error:
        first = error.errors()[0]
        raise TrainingFailed(f"{path}: {'.'.join(map(str, first['loc'])) or 'the file'}: {first['msg']}") from error
