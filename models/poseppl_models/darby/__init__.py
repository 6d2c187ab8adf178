"""Darby, Li and Costen (2008): a ten-cone body, its likelihood and its learned activity."""
