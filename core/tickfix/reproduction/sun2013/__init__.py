"""Wi-Fi fingerprinting by normalised cross correlation, and the Kalman/map filter: the experiments of [sun2013]."""
