"""What people and programs that write G-code need: rules, grammars, fixes, formatting, editors, agents."""
