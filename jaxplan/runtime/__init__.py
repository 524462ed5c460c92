"""How work is done, whatever it is about: many at once."""
