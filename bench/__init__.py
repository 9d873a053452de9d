"""Benchmarks: every claim of speed or quality in the docs, with its baseline measured in the same run."""
