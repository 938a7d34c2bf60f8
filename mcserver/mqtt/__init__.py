"""MQTT: states of all machines for a broker, as plain topics or Sparkplug B; only a rebirth is obeyed."""
