"""From sound to phones: phone sets and where phones begin and end."""
