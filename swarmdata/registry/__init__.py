"""Everything that the package ships by name: components, presets, published data, references."""
