"""How work is done, whatever it is about: many at once, compiled, in threads, roots followed."""
