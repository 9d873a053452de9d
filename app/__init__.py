"""Mary: text in, a live photoreal talking head out."""
