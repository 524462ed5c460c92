"""Tools for any kind of work: many problems at once, compiled code, threads, progress, roots of equations."""
