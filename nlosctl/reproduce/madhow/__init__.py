"""Ananthasubramaniam and Madhow: figures."""
