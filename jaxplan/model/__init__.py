"""The planning problem as data, with its geometry and kinematics; neither files nor solvers are in here."""
