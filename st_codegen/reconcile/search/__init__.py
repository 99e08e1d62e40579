"""The search for effects: candidates, where resonances lie, and the tests that an addition must pass."""
