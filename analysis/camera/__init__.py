"""The camera: its model, the boards that it sees, lens and poses from them."""
