"""From models as operations to the text of a target."""
