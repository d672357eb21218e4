"""The floor of a scene: how high it lies (`ground`), and where people can stand and walk on it (`planning`)."""
