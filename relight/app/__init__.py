"""The local web application: drop a photograph, outline the person, move the lights, download the picture."""
