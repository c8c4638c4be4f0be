"""From a behavior density and a critic to a policy."""
