"""The papers: one module each, with the numbers it published and how they are measured here."""
