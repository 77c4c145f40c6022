"""HTTP API of the ward for programs: JSON, with an OpenAPI document generated from the response types."""
