"""`taau`: temporal upsampling without a network."""
