"""What exists: geometry, the body in it, and motion as data. Imports neither objectives nor scenectl."""
