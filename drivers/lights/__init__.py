"""What drivers of lights share."""
