"""The sample scenes: each module describes one, `usda` and `glb` write them."""
