"""From a recording to an avatar pack."""
