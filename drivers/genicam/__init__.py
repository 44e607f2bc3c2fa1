"""GenICam cameras (USB3 Vision and GigE Vision) through Aravis."""
