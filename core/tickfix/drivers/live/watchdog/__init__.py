"""Who looks after an engine from outside: signs of life, and what is done when there are none."""
