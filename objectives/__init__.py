"""What is wanted: goal functions and how they compose. Imports scenes only."""
