"""`python -m app` is the command `mary`."""

from app.cli import main

main()
