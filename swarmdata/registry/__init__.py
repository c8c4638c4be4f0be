"""What the package ships by name: components, presets, published datasets and references."""
