"""CatBoost's models, from their JSON export."""
