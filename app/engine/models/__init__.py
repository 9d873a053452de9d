"""Trajectory models side by side: what they share, how they are stored, and one module for each of them."""
