"""The paper's own planners and trajectory (sections 3.2 and 4), as methods that settings name."""
