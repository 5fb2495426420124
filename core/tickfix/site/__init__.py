"""Sites: floors, radio map and trained models of a building, how a survey makes one, and the folder that stores it."""
