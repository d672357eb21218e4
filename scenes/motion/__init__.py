"""Motion as data: skeletons, joint positions over time, headings, rotations and bones."""
