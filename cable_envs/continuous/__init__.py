"""Plants in continuous time, without Gymnasium: f(x, u), rest, linearisation, integration, and CasADi."""
