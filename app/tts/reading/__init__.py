"""How English text is read aloud: each module turns one kind of written thing into plain words."""
