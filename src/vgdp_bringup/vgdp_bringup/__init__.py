"""What brings the stack together: demo, recorder, launch files and the ``vgdp`` command."""
