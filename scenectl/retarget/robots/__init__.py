"""Motions for humanoid robots: MJCF and URDF in, joints over time out. Needs the extra `robots` (MuJoCo and mink)."""
