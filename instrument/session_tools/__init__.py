"""What is done with whole sessions: verify, look over, pack, export."""
