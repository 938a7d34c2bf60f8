"""An open motion server: G-code over Zenoh to moving axes."""
