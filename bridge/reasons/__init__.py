"""Why something is so, as codes with parameters; and the catalogue that makes text of them, one file a language."""
