"""A benchmark for writers of programs: tasks in words, and a judge that simulates what they answer."""
