"""From text to speech with phone times: one file an engine, one registry."""
