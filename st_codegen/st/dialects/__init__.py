"""What the dialects of Structured Text allow."""
