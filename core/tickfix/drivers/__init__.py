"""Drivers: where events come from and how waiting is done. They differ in nothing else; the kernel does the rest."""
