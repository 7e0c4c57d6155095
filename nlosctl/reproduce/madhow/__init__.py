"""Figures of Ananthasubramaniam and Madhow."""
