"""Adding an effect to a MuJoCo model: a native element where one exists, else an applied torque."""
