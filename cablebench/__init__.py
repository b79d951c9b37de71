"""Protocol, metrics, statistics, evaluation and boards for the environments of `cable_envs`.

How a command line calls it (nothing here imports torch; rich, jinja2 and matplotlib are imported where they are used)::

    from cablebench.board import build_board, print_board, render_json, write_board
    from cablebench.entrants import agent_entrant, controller_entrant, entering, reference_entrants
    from cablebench.protocol import load_protocol, measure
    from cablebench.run import ResultStore, evaluate, run_episode

    protocol = load_protocol("quick")
    store = ResultStore("results/quick.jsonl")
    entrants = entering(reference_entrants(), protocol)                      # all, or (names); those that apply
    entrants += (controller_entrant("pid", gains={"kp": 900.0}),             # other gains
                 agent_entrant("ppo", policy, env_id, training_seed=0, environment_steps=200_000, path="runs/ppo.zip"))
    evaluate(protocol, entrants, store=store, progress=lambda p: print(p.done, p.total, p.text))
    board = build_board(protocol, store.records())
    print_board(board, rich_console)
    paths = write_board(board, "results/quick", store.trajectories.of)       # {"json", "markdown", "html": Path}
    text = render_json(board)                                                # what --json prints

    env = gymnasium.make(env_id, **options)                                  # one episode:
    actor = entrant.make(env.unwrapped.setup)                                #   entrant.needs(env_id, setup) -> options
    episode = run_episode(env, actor, seed)                                  #   `Episode` arrays
    values = measure(episode)                                                #   {name: SI value}

Folders, each importing only those after it: ``cli`` (one file a command), ``concealed`` (control of rigs that have
more than any simulator), ``export`` (datasets and recordings), ``pages`` (HTML about diagnoses), ``tune``, ``board``
(ranking), ``run`` (episodes and their records), ``entrants`` (who takes part), ``jobs`` (processes, Ray), ``protocol``.
"""
