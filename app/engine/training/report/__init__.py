"""`report.html`: what an avatar was learnt from, and how well, to be looked at after every training."""
