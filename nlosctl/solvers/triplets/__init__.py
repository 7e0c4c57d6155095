"""Behind the methods for triplets."""
