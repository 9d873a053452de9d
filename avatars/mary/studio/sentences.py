"""What Mary says in her recording: every ARPAbet phone at least three times."""

SENTENCES = (
    "Hello, my voice and my face belong together.",
    "Both of us should choose a warm yellow coat.",
    "Five brave foxes jump over the thick fence.",
    "She usually measures the thin paper with pleasure.",
    "The boy enjoys how loud the town sounds today.",
    "Please keep the good blue book by your bed.",
    "What an odd job, watching shy hungry lambs graze!",
    "That nurse heard a small bird chirp early.",
    "I thought the azure garage door was huge.",
    "Thank you for waiting, we can begin right now.",
)
"""Append to extend the recording: what was rendered before keeps its frames, but for the last three."""
