"""Build and install vgdp_planner; its version stands in package.xml alone."""

from xml.etree import ElementTree as ET

from setuptools import find_packages, setup

PACKAGE = 'vgdp_planner'
MANIFEST = ET.parse('package.xml')

setup(
    name=PACKAGE,
    version=MANIFEST.findtext('version'),
    description=MANIFEST.findtext('description'),
    license='Apache-2.0',
    python_requires='>=3.11',
    packages=find_packages(),
    package_data={
        PACKAGE: ['py.typed', 'weights/**/*.safetensors', 'weights/**/*.json', 'weights/**/*.md']
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
    ],
    zip_safe=False,
    entry_points={
        'console_scripts': [
            'planner_node = vgdp_planner.node:main',
            'waypoint_follower_node = vgdp_planner.waypoint_follower_node:main',
        ]
    },
)
