"""The method `surrogate`: indices from few runs, whose error held-out runs correct and bound."""
