"""The same ward for programs: JSON over HTTP, described by an OpenAPI document that is made of the types it answers with."""
