"""The balance of torques as a linear model: its terms, its fit, and how sure the fit is."""
