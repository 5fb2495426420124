"""[jiang2015]: motion by extreme learning machines, Wi-Fi fixes and a particle filter that joins them, in one room."""
