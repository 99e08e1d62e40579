"""Runs checked text."""
