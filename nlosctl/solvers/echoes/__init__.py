"""Behind `identify-los`: candidates, their assignment, clusters."""
