"""On the controller: a soft PLC that answers clients, the live comparison, and the recording of campaigns."""
