"""ament_python package: three Python packages, their executables and their data."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'flex_payload'
ROS_WHEELS = [
    'ros-rclpy[fastrtps]==9.1.2',
    'ros-diagnostic-msgs~=5.5.1',
    'ros-geometry-msgs~=5.5.1',
    'ros-rosgraph-msgs~=2.3.0',
    'ros-sensor-msgs~=5.5.1',
    'ros-std-msgs~=5.5.1',
    'ros-std-srvs~=5.5.1',
    'ros-trajectory-msgs~=5.5.1',
    'ros-visualization-msgs~=5.5.1',
]
AMENT_FLAKE8 = [
    'flake8',
    'flake8-blind-except',
    'flake8-builtins',
    'flake8-class-newline',
    'flake8-comprehensions',
    'flake8-deprecated',
    'flake8-docstrings',
    'flake8-import-order',
    'flake8-quotes',
]
DOCS = ['furo', 'myst-parser', 'sphinx']

setup(
    name=PACKAGE,
    version='0.1.0',
    description='Two-link flexible arm: simulation, diagnosis and payload estimation in ROS 2',
    license='Apache-2.0',
    maintainer='flex_payload maintainers',
    maintainer_email='maintainers@users.noreply.h-seed-451643e1.example',
    python_requires='>=3.10',
    packages=find_packages(include=[
        'flex_plant_sim', 'flex_plant_sim.*',
        'flex_payload_estimator', 'flex_payload_estimator.*',
        'msg_config',
    ]),
    package_data={
        'flex_plant_sim': ['robots/*.yaml', 'diagnosis/report/*.html'],
        'flex_payload_estimator': ['fleet/*.html'],
        'msg_config': ['*.yaml', '*.xml'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/launch', ['launch/estimator.launch.py',
                                     'launch/flex_payload.launch.py']),
        (f'share/{PACKAGE}/config', sorted(glob('config/*'))),
    ],
    install_requires=['setuptools', 'numpy', 'scipy', 'PyYAML', 'matplotlib'],
    extras_require={
        'ros': ROS_WHEELS,
        'bags': ['rosbags'],
        'report': ['jinja2', 'tqdm'],
        'speed': ['numba'],
        'fleet': ['distributed', 'jinja2', 'pyarrow', 'tqdm'],
        'docs': DOCS,
        'bench': ['filterpy', 'mujoco', 'numba'],
        'test': [
            'colcon-common-extensions', 'cyclonedx-bom', 'hypothesis', 'mypy~=2.4', 'packaging',
            'pydocstyle', 'pytest', 'pytest-cov', 'pytest-xdist', 'ruff~=0.17.5', 'types-PyYAML',
            *DOCS,
            *AMENT_FLAKE8,
        ],
    },
    entry_points={
        'console_scripts': [
            'plant_sim = flex_plant_sim.nodes.start:plant_sim',
            'payload_estimator = flex_payload_estimator.nodes.start:payload_estimator',
            'lqg_controller = flex_payload_estimator.nodes.start:lqg_controller',
            'flex_compile = flex_payload_estimator.tools.compile:main',
            'flex_demo = flex_payload_estimator.tools.demo:main',
            'flex_diagnose = flex_payload_estimator.tools.diagnose:main',
            'flex_estimate = flex_payload_estimator.tools.estimate:main',
            'flex_fleet = flex_payload_estimator.tools.fleet:main',
            'flex_figures = flex_payload_estimator.tools.figures:main',
            'flex_replay = flex_plant_sim.tools.replay:main',
            'flex_robot = flex_plant_sim.tools.robot:main',
        ],
    },
    zip_safe=True,
)
