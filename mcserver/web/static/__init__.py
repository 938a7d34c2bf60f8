"""What the browser loads besides NiceGUI's own files."""
