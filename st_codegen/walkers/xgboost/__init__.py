"""XGBoost's model files, JSON and UBJSON."""
