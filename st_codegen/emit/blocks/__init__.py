"""Intermediate representation -> what a function block declares and computes, ready for templates."""
