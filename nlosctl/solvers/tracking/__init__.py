"""Paths of moving sources: smoothers and filters over states with a position and a velocity."""
