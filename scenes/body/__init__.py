"""The person or robot in the scene: capsules on bones, and the files that characters come from."""
