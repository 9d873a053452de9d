"""What `mary evaluate` finds out: figures, tables and plots."""
