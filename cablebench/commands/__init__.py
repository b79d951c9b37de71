"""The commands of ``cablebench``, one file each; what they import at call time keeps ``cablebench --help`` quick."""
