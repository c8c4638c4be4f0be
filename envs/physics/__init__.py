"""Physics: robot dynamics, contacts, and the backends that simulate them."""
