"""Shen and Molisch: figures and tables."""
