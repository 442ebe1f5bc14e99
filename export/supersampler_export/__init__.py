"""From torch methods to the model folders that the SDK drives. Needs the `train` extra."""
