"""From an id or an address to an open dataset, and repair of what is broken."""
