"""Behind the methods for ranges."""
