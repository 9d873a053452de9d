"""What the longer commands of `mary` do; `app.cli` has their arguments."""
