"""Build and install vgdp_bringup; its version stands in package.xml alone."""

from glob import glob
from xml.etree import ElementTree as ET

from setuptools import find_packages, setup

PACKAGE = 'vgdp_bringup'
MANIFEST = ET.parse('package.xml')

setup(
    name=PACKAGE,
    version=MANIFEST.findtext('version'),
    description=MANIFEST.findtext('description'),
    license='Apache-2.0',
    python_requires='>=3.11',
    packages=find_packages(),
    package_data={PACKAGE: ['py.typed', 'quick_discovery.xml', 'quick_images.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/launch', sorted(glob('launch/*.launch.py'))),
        (f'share/{PACKAGE}/rviz', sorted(glob('rviz/*.rviz'))),
        (f'share/{PACKAGE}/foxglove', sorted(glob('foxglove/*.json'))),
        (f'share/{PACKAGE}/config', sorted(glob('config/*.yaml'))),
    ],
    zip_safe=False,
    entry_points={
        'console_scripts': [
            'recorder_node = vgdp_bringup.node:main',
            'vgdp = vgdp_bringup.cli:main',
        ]
    },
)
