"""What is planned for, as data and geometry: no files, no solvers."""
