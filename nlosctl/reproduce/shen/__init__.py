"""Figures and tables of Shen and Molisch."""
