"""The ward for programs: JSON over HTTP, with an OpenAPI document made of the types it answers with."""
