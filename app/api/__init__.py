"""The HTTP interface: FastAPI routes in one small module for each thing they serve. No numerics, no codecs."""
