"""What a fit entitles one to say: candidates, evidence, names, changed parameters, suspects, the unexplained."""
