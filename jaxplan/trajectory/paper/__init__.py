"""The paper's scheme (section 4), corrected: segments on charts of SO(3), planned one after another."""
