"""Sites: floors, radio map and trained models of a building, and the folder that keeps them."""
