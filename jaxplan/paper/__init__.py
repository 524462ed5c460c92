"""The printed planners and the printed trajectory, as methods that settings name (sections 3.2 and 4)."""
