"""What a user brings: a folder of model files, and what the models are for."""
