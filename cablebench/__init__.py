"""Protocol, metrics, statistics, evaluation and boards for the environments of `cable_envs`.

How a command line calls it (nothing here imports torch; rich, jinja2 and matplotlib are imported where they are used)::

    protocol = load_protocol("quick")                                        # cablebench.run.protocol
    store = ResultStore("results/quick.jsonl")                               # cablebench.run.store
    entrants = reference_entrants()                                          # cablebench.entrants.entrant: all, or
    (names) entrants += (controller_entrant("pid", gains={"kp": 900.0}),             #   other gains
                 agent_entrant("ppo", policy, env_id, training_seed=0, environment_steps=200_000, path="runs/ppo.zip"))
    evaluate(protocol, entrants, tasks=(), tracks=(), store=store,           # cablebench.run.evaluate
             progress=lambda p: print(p.done, p.total, p.text))
    board = build_board(protocol, store.records())                           # cablebench.board.board
    print_board(board, rich_console)                                         # cablebench.board.report
    paths = write_board(board, "results/quick", store.trajectories)          #   {"json", "markdown", "html": Path}
    text = render_json(board)                                                #   what --json prints

    env = gymnasium.make(env_id, **options)                                  # one episode:
    actor = entrant.make(env.unwrapped.setup)                                #   entrant.needs(env_id, setup) -> options
    episode = run_episode(env, actor, seed)                                  #   `Episode` arrays
    values = measure(episode)                                                # cablebench.run.metrics: {name: SI value}
"""
