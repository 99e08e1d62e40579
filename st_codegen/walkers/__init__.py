"""Trained models in: one file a library or kind turns them into the intermediate representation."""
