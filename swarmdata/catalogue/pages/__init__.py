"""The HTML pages of the catalogue; whatever comes from files is escaped by `catalogue.elements`."""
